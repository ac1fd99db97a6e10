"""Speed against error: draws and times configurations, compares them with the path tracer, and reports."""
