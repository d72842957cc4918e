"""Tests of `glider.commands`."""
