"""Figures, specified once and drawn for a page or a file.

figure: what a figure is made of. style: colours, dashes, names. binning: what many
points become. as_file: pictures.
"""
