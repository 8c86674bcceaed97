"""Show robots: pictures, recordings, web pages."""
