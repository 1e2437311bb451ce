"""Measurements of lidarcli: speed (`make bench`) and accuracy (`make accuracy`)."""
