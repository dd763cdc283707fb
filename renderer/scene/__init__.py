"""From a source (file, dictionary, gallery name) to a scene that can be rendered: parse, vet, measure, instantiate."""
