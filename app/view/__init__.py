"""The viewer: a web page that controls the renderer and shows its frames live."""
