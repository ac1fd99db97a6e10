"""OpenGL plumbing: context, shaders, textures, geometry, lights, timers."""
