"""ElasticFusion: a surfel map that loops deform (Whelan et al. 2015)."""
