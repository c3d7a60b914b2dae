"""The SDO client: channels and the transfers on them."""
