"""Worlds for choosing the weight of WiFi edges: those of graph_slam, with seeds of their own.

See Gu et al., eq. 5, whose Omega is not printed. What is chosen on these worlds is judged on others.
"""

from positioning.simulation.graph_slam import simulate

__all__ = ["simulate"]
