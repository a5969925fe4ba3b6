"""Rotations, attitude laws and torque-free motion."""
