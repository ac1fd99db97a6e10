"""How far a picture is from its path-traced reference, and how long it takes."""
