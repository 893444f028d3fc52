"""Pictures of a simulated station: renderers, mirrors, cards."""
