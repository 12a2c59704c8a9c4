"""What a stage can be asked and what it tells: requests, answers and endpoints, each typed once."""
