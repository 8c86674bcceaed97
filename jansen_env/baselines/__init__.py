"""Controllers to compare policies with."""
