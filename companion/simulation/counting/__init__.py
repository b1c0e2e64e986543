"""Shares of flights with their confidence, and what a change did to them."""
