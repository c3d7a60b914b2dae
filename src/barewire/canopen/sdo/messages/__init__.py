"""SDO messages: each a frozen dataclass with `encode` and `decode`."""
