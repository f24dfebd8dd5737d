"""Which geometry is best? Parameters of a mechanism file varied,
judged by quantities of maps.
"""
