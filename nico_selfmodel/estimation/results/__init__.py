"""What every calibration returns, how it is judged and how it is written down: once."""
