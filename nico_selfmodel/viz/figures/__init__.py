"""Figures: matplotlib drawings of one question each, the answer in the headline."""
