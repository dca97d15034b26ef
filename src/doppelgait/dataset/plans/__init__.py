"""Built-in dataset plans, one TOML file each."""
