"""Recordings and telemetry in, features and quality out; knows no database and no single axis."""
