"""Path-traced references: Mitsuba scenes, a diffuse path tracer and a tracer of environment light."""
