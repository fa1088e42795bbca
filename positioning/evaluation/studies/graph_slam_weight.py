"""What is counted of these walks: as in graph_slam.

See Gu et al., section IV.
"""

from positioning.evaluation.studies.graph_slam import measures

__all__ = ["measures"]
