"""Robust6DoF's network: fusion, augmentation, keypoints and matching."""
