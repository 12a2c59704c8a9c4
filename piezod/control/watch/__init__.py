"""What looks for faults: values in, detections out."""
