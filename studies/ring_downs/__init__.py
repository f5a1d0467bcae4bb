"""Simulated ring-downs with viscous, dry and quadratic damping: are kind, numbers and intervals right?"""
