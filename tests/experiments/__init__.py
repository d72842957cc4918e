"""Tests of `glider.experiments`."""
