"""The families of ``EVERYDAY_FAMILIES``, one module each, and the parts they share."""
