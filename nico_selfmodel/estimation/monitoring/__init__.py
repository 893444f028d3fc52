"""A body that changes: alarms and their causes, encoder zeros, tools."""
