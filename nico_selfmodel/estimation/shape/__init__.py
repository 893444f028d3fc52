"""The outer shape of links: of those that stand still in mirrors, of those that move directly."""
