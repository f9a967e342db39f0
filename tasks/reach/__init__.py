"""Reaching tool poses."""
