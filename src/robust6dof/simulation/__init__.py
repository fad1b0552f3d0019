"""Vehicle, arm, camera and target; the closed loop."""
