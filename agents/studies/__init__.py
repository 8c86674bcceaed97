"""Studies: many training runs, planned, run here or on Ray, and compared over seeds."""
