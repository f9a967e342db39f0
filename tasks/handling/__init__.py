"""Picking, holding and placing, shared by tasks."""
