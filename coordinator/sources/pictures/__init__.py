"""Depth as a folder of pictures: their names and times, Open3D's folders, TUM's, colour beside depth."""
