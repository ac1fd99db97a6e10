"""One file per pass. A pass is data first (its reads and writes), code second; passes never import each other."""
