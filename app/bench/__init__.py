"""Speed against error: times configurations and baselines, compares them with the path tracer, and reports."""
