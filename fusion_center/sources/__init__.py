"""What carriers say, report by report: coordinates, the logs of a target, tracks of a source."""
