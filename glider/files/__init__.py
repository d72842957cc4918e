"""Files whatever is in them.

writing: all of a file, or of a folder's files, or nothing. recognition: what a file is.
"""
