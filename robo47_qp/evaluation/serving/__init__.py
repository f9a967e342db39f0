"""Policies over a websocket: a server that answers observations with actions."""
