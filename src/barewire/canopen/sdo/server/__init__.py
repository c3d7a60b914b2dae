"""The SDO server: responses from an object dictionary."""
