"""What a run leaves for people: report, plots, video, recording."""
