"""Simulation-based calibration of models and samplers."""
