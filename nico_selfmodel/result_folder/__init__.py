"""Result folders: written whole or not at all, without a plot library."""
