"""Files in and out: images, video, checked JSON, child processes; every file appears whole or not at all."""
