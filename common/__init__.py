"""What coordinator and worker must agree on: the body, the camera, the settings, the wire."""
