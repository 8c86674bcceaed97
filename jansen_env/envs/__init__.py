"""Gymnasium environments of one robot and of many robots, for every task."""
