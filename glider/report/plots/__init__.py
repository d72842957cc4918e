"""Figures of pages, as data.

figure: what a figure is made of. style: colours, dashes, names. binning: what many
points become.
"""
