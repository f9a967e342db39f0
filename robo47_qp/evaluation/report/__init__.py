"""What an evaluation leaves for people: report, comparison, picture, progress."""
