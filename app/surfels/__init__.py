"""World surfels: points on the scene's surfaces with traced light paths between them. NumPy and Embree; no GL."""
