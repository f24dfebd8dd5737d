"""Answers: what is said about a posture, or to another question,
as plain data without words.
"""
