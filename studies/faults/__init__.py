"""Plausible faults of metadata, sensors and physics through the whole command: what does it end in?"""
