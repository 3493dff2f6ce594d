"""Tests that hide an effect in generated data and require the product to find it."""
