"""PIC-SERVO boards: the protocol, the line that they hang on, the arm that they move."""
