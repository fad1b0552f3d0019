"""The aerial manipulator: arm, camera Jacobian, limits."""
