"""Pure mathematics: transforms, rotations, cameras, points, boxes, alignment."""
