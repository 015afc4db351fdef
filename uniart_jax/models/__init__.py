"""The networks. ``models.network.build`` makes any of them as a pure function; modules are imported
when built."""
