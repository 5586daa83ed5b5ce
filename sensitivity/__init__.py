"""How results depend on parameters: derivatives, identifiability and global indices."""
