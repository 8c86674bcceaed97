"""The search for walking linkages; ``python -m agents.design`` begins one."""
