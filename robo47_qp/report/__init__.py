"""What a run leaves for people: report, audit, plots, video and recording."""
