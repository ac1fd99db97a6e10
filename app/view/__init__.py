"""The viewer: a page in the browser that steers the renderer and shows its frames as they are drawn."""
