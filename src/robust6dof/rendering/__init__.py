"""Meshes and a camera to colour, depth and mask; what a real sensor makes of them."""
