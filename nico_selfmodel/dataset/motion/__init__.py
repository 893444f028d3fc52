"""What joints were told over time, and what their encoders read."""
