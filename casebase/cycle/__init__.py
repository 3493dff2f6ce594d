"""The four steps of case-based reasoning (Aamodt and Plaza 1994): retrieve, reuse, revise, retain."""
