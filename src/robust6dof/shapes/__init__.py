"""Textured meshes: procedural categories, users' own meshes, category priors."""
