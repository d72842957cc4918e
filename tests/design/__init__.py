"""Tests of `glider.design`."""
