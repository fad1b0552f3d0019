"""From a frame and a prediction to the next pose."""
