"""Estimates as files and pictures."""
