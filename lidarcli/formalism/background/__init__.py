"""§3: a background is learned, and a sweep subtracted from it: r_w − r_e."""
