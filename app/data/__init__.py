"""Files that come with the program: the embedded scene and the scene JSON's schema."""
