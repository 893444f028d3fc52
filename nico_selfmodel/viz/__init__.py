"""Scenes, figures, reports and live views; nothing below knows that pictures exist."""
