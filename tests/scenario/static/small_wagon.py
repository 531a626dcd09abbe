"""A short wagon with one Kinect, as a scene and as settings."""

ROOM = """
[wagon]
length = 5.0
width = 2.7
height = 2.4
[[sensor]]
name = "k0"
kind = "kinect"
"""
SCENE = ROOM + """position = [0.1, 1.35, 2.2]
look_at = [4.0, 1.35, 0.6]
"""
