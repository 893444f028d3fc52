"""One problem: any body, any sensors, one adjustment."""
