"""Player logs: what the writelog driver of Player/Stage writes."""
