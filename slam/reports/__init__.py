"""Reports of runs as tables, pages, pictures and meshes."""
