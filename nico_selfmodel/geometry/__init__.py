"""Circles, planes, lines, rigid transforms and alignment: numpy only, nothing of robots."""
