"""The laboratory of the gateway: see `__main__`."""
