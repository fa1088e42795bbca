"""Graphs of poses: what ties them, how far they contradict it, and the poses that contradict it least."""
