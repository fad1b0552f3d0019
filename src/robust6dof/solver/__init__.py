"""Keypoint pairs and canonical coordinates → transforms: RANSAC, PnP, absolute and joint fits."""
