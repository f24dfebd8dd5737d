"""The words of a mechanism file: data classes that files of several kinds share."""
