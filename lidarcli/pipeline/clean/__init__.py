"""`clean`: a log written once more without what moves in it, mended, or in parts."""
