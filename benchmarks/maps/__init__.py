"""How right maps are, beside the rules of published programs: `make maps` measures it and writes docs/maps.md."""
