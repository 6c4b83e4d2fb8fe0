"""Six-axis force-torque sensors: predicting, identifying and removing what the tool itself does to the readings."""
