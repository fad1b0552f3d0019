"""The paper's network: stage 1 (fusion), stage 2 (augmentation), stage 3 (keypoints, matching)."""
