"""What bends in an arm: which effects the data tell, and of which unseen poses gain."""
