"""Sphinx extension: drawings of the glider and of a Drake diagram.

`python docs/extensions/drawings.py` writes them into docs/pictures, from where README
shows them too; a build of the docs fails where they are out of date.
"""
