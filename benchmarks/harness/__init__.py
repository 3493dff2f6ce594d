"""What banks, benchmarks and tests ask the service with: processes, clients, sounds and logs that are known."""
