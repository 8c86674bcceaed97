"""Search for walking linkages; start a search with ``python -m agents.design``."""
