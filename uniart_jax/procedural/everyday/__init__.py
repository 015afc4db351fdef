"""``EVERYDAY_FAMILIES``, a file each, and what they are made of."""
