"""Programs for tasks of robosuite, and the client that lets robosuite judge them."""
