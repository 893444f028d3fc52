"""Drive a body through poses and return what it sensed as a data set.

Any body will do: a simulated arm under motion capture, or a station with cameras, of real servos or
simulated ones. A recording that is written to a folder is there from the first pose on, whole and
loadable, and goes on where it stopped; poses that come faster than they are written are written
together.
"""
