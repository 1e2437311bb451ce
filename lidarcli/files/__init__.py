"""Files and objects of stores: those that get their names when they are whole, and TOML and YAML."""
