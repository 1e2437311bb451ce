"""How right the detection is: simulated scenes with a known answer, published formulas beside it (docs/accuracy.md)."""
